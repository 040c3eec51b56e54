"""Several motions as one that goes through their ends without a stop."""
