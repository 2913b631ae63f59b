"""Programs that the benchmarks compare with: another filter, another master, and plain C."""
