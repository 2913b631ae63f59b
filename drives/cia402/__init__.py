"""CiA 402, master side: power state, PDOs, units and the files that describe a drive.

Reading order: `power_state.py` (statusword in, one controlword out), `pdo.py`, `units.py`,
`torque.py`, `option_codes.py`, `homing.py`, `sources.py` (what each fact rests on); `profile.py`
with `emergencies.py`, and `axis_file.py` (the files of a drive); `drive.py` (one drive, and all
drives of a bus, in the cycle) with `temperature.py` (what is read by SDO meanwhile).
"""
