"""The processes that compute a study: a pool on this computer, or a cluster."""
