"""daemon.gateway."""
