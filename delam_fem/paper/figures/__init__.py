"""The figures of the paper, one group each."""
