"""Where the search starts: controllers that are known or drawn, before any training."""
