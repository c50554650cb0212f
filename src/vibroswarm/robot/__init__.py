"""The robot's program: scalars in, scalars out; it knows only sensors, clock and radio.

The simulators step it, and C for microcontrollers is translated from it (``export``): it uses only ``math``. Uniform
random numbers are passed in.
"""
