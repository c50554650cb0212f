"""What a robot says and when it decides (Algorithms 1, 3); one strategy a file, scalars in, scalars out."""
