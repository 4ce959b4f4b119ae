"""Training of the bundled oriented detector; needs the extra ``train`` (torch, onnx). The program never loads it."""
