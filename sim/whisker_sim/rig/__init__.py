"""The calibration rig at rest: what its whisker and its magnetometer read for every place and depth of the ruler."""
