"""Numerics only: from positions and efforts to friction and patient activity. No I/O, no clock.

Reading order: `parameters` (what a leg is made of), `mechanism` (its derivation, and what Python
calls), `linkage` (the same as pieces of kernels), `friction` (laws 11 to 13), `leg_model` (all
eight states over one step), `cdkf` (the filter, for any model), `leg_filter` (one cycle of the
leg's filter, with `leg_memory` and `leg_judgement`), `leg_observer` (the object that the service
holds), `batch` (the same over recorded columns). `states` and `status` are the words for results;
`jit` says how all of it is compiled and why its cache cannot be stale; `elementary` has the
functions that let loops become vector code.
"""
