"""The robot's program, written once: scalars in, scalars out; it knows nothing but sensors, clock and radio.

The simulators step it, and a small Python on a microcontroller could run it: it uses only ``math``. Chance
comes in as uniform numbers.
"""
