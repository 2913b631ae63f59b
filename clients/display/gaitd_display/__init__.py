"""Pages for the patient, the therapist and the engineer of a gait trainer.

Reading order: `settings.py` (the three configuration files), `feed.py` (messages of the trainer and
the queue of each page), `walk.py` (steps, gauge and word), `way_out.py` (out of a latched stop,
alone), `training.py` (the session), `scenes.py` (what is said in each state), `patient_view.py`
(all that the patient's page shows), `cause_texts.py` and `texts.py` (words in two languages),
`alarm.py`, `controls.py` (what a therapist can do now), `therapist_texts.py`, `stop_texts.py` and
`event_texts.py` (a therapist's words), `plan_ranges.py` (what a plan may allow),
`therapist_view.py`, `progress.py` (profile, plan and sessions), `profile_form.py` and
`profile_file.py` (the profile is changed), `truth.py` (file of the virtual drives), `geometry.py`
and `engineer_view.py`; then `connections.py` (which ones a server holds), `messages.py` (the
messages for programs of other people), `web.py` (headers, origin, WebSocket, STOP), `patient.py`,
`login.py`, `therapist.py`, `engineer.py`, `__main__.py`.
"""
