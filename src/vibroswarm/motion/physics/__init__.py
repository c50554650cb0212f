"""Motion by a rigid-body simulator: MuJoCo moves the robots, our program drives them through sensors and motors."""
