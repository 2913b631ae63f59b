"""`gaitd gateway` that has loaded everything and begins at a line on stdin: a restart in no time.

waiting_gateway.py gateway --config FILE
"""

import sys
from importlib import import_module

for name in ("zenoh", "daemon.gateway.process", "daemon.config.trainer", "gaitd.gateway"):
    import_module(name)
main = import_module("gaitd.__main__").main

print("gateway waits", flush=True)
sys.stdin.readline()
main()
