"""A robot arm that carries two arrays of whiskers past objects that stand free on a table."""
