"""The ``.ndf`` file and its public face, `asset.Asset`. Numpy only; nothing here imports torch or a plugin."""
