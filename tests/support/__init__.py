"""Helpers of the tests: small datasets, rooms, servers, falsifications."""
