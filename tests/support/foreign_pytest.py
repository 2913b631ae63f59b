"""What a pytest finds that a test starts for somebody else: none of the options given to ours."""

import os

ENVIRONMENT = {name: value for name, value in os.environ.items() if name != "PYTEST_ADDOPTS"}
