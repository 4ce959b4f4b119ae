"""Training of front classifiers (``vision.detect.front``): on renders, or on crops of one's own videos.

Needs the extra ``train`` (torch, onnx). The program never loads it.
"""
