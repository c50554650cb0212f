"""The robot's program outside of the package: C99 for microcontrollers."""
