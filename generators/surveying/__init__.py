"""`avs3d scan`: what a stranger's scan holds, as a manifest that generates at once and a page to check it by.

Start reading at `generators.surveying.survey`.
"""
