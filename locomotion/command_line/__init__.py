"""From what stands on a command line to a checked configuration and the folder of a run."""
