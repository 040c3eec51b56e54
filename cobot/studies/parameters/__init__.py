"""Parameters of studies: their spaces, studies that sample them, and the search for the best."""
