"""Programs of arms as the subject of a study."""
