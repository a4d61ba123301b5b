"""Scenes of the project's own, rendered with Mitsuba 3 as the ground truth."""
