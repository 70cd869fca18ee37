"""Families of models for training: each call draws another product, unlike those of the benchmark."""
