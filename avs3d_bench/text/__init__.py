"""Text from anywhere, made fit for a line, a cell or a page."""
