"""sim_drives."""
