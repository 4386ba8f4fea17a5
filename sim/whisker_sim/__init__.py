"""Simulation of whisker sweeps in MuJoCo: scenes are read, traces with ground truth are written.

All quantities are in SI units, stated in their names; `datasets/FORMAT.md` specifies the files. Only the MuJoCo model, built by
`model`, is in millimetres, grams and seconds.
"""

__version__ = "0.1.0"
