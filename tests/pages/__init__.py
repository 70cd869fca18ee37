"""Tests of what a newcomer meets: pages, examples, Makefile, wheel and image."""
