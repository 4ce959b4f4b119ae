"""Training of front classifiers (``vision.front``): on renders, or on crops of one's own videos that label themselves.

Needs the extra ``train`` (torch, onnx). The program never loads it.
"""
