"""All of z2p but its pure core: `pipeline`, `plugins`, `storage` and `workflows`, under a name that is ours alone.

Installed, those four are folders of this package. In a checkout they lie beside it, at the top level, where readers
look for them: then the checkout's root is one more place to look. So neither a user's own ``pipeline.py`` nor a folder
``storage`` beside a script can stand in for ours.
"""

from pathlib import Path

_HERE = Path(__file__).parent
if not (_HERE / "pipeline").is_dir():
    __path__.append(str(_HERE.parent))
