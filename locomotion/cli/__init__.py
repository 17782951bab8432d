"""From a command line to runs, and to what is done with their policies."""
