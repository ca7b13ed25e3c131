"""Studies: functions from a scene to a Dataset that answers one question."""
