"""The results of a study: its folder, its table, its maps."""
