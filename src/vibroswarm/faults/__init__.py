"""Robots that fail: who, and from when on (``assignment``), and what sensors that fail read (``sensor_faults``)."""
