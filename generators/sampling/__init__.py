"""Samples manifests: plausible observations of all parts in procedural homes that no other manifest uses.

Start reading at `generators.sampling.sample`; `siblings` says what sounds in a group of part_3, `excluded` what other
manifests use, `fitting` which observations fit into their rooms, `statistics` what the command prints.
"""
