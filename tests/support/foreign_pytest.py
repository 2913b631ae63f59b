"""The environment of a pytest of another project: without the options that ours was given."""

import os

ENVIRONMENT = {name: value for name, value in os.environ.items() if name != "PYTEST_ADDOPTS"}
