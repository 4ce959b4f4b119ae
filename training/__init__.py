"""Training of the bundled oriented detector; needs the extra ``train`` (torch, onnx) for all but reading images.

Of the program only ``gcs train-detector`` loads it.
"""
