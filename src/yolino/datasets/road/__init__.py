"""The parts of the synthetic road scene: the view, the lanes, the ground and all that stands on it."""
