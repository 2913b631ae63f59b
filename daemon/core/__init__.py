"""daemon.core."""
