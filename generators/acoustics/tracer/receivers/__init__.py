"""Receivers: from the arrivals at a listener to binaural, ambisonic and microphone array responses."""
