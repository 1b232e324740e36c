"""``python -m z2p_renderer.pipeline.export WEIGHTS...``: writes the ONNX file beside each."""

import sys

from z2p_renderer.pipeline.export import export_onnx
from z2p_renderer.storage.models.checkpoints import WeightsError, find_weights

if len(sys.argv) < 2:
    sys.exit(__doc__)
for argument in sys.argv[1:]:
    try:
        print(export_onnx(find_weights(argument)))
    except (WeightsError, ImportError) as error:
        sys.exit(f"Error: {error}")
