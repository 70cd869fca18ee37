"""The paper behind the benchmark."""

from __future__ import annotations

PAPER = "3D Audio-Visual Segmentation"
AUTHORS = ("Artem Sokolov", "Swapnil Bhosale", "Xiatian Zhu")
ARXIV = "2411.02236"
BIBTEX = f"""@misc{{sokolov2024audiovisual,
  title         = {{{PAPER}}},
  author        = {{{" and ".join(AUTHORS)}}},
  year          = {{2024}},
  eprint        = {{{ARXIV}}},
  archivePrefix = {{arXiv}},
  primaryClass  = {{cs.CV}}
}}"""
