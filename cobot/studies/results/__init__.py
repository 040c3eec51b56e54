"""The results of a study: its folder, its table and its maps."""
