"""The robot's program: scalars in, scalars out; it knows only sensors, clock and radio.

The simulators step it, and MicroPython on a microcontroller could run it: it uses only ``math``. Uniform random
numbers are passed in.
"""
