"""Random suites: scenes drawn from a seed.

A set is one whisker on one object with one kind of motion, rate, noise and miscalibration; its traces differ in the pose of the
object, the place of the contact and the course of the motion. The random stream of everything that is drawn depends only on the
suite's name, its seed, and the number of the set, so that a set does not depend on the others and suites of different names or
seeds share no scene.
"""
