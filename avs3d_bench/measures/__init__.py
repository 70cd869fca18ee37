"""Measurements that several packages share: levels, reverberation, silhouettes, deaf oracles."""
