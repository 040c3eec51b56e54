"""Recordings of a robot as MCAP files: their content, their folder, plots and replays."""
