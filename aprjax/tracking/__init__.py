"""Where the robot is in a map (paper 4): hypotheses, their sources and their evidence."""
