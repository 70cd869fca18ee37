"""The contract on disk: names of files and folders, categories, and the records behind every JSON file."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(__name__, submodules=["layout", "schema", "taxonomy"])
