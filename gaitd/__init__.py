"""gaitd."""
