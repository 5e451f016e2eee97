"""Measurements of jaxrmp: `python -m benchmarks NAME [--json FILE]`."""
