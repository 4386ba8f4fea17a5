"""Whisker sweeps in MuJoCo: scenes in, traces with ground truth out.

Every quantity is in SI units and carries its unit in its name; `datasets/FORMAT.md` specifies the files. The one place that
leaves SI is `model`, which builds the MuJoCo model in millimetres, grams and seconds.
"""

__version__ = "0.1.0"
