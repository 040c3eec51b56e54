"""The processes that compute a study: a process pool on this computer, or a cluster."""
