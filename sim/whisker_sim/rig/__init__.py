"""Static model of the calibration rig: readings of whisker and magnetometer for every position and depth of the ruler."""
