"""Objects and sounds made by others: their sources, licences, storage and integrity checks.

Every asset is pinned in a lock file (`assets.lock.yaml` beside the manifest); the files themselves are in a store
outside the repository. `avs3d assets` fills both; generation opens assets with `open_asset`.
"""

from __future__ import annotations

from generators.library.lock import LOCK_NAME, AssetEntry, Lock, read_lock, update_lock
from generators.library.store import Store, open_asset

__all__ = ["LOCK_NAME", "AssetEntry", "Lock", "Store", "open_asset", "read_lock", "update_lock"]
