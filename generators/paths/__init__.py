"""The agent's walk and gaze, and the motion of sources."""
