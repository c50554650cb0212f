"""The robot's program, which knows only sensors, clock and radio: scalars in, scalars out, ``math``, fixed memory.

The simulators step it, and C for microcontrollers is translated from it. Uniform random numbers are passed in.
"""
