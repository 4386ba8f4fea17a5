"""Scenes in space: a whisker that bends about two axes and twists, a solid, and a base with six degrees of freedom."""
