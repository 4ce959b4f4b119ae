"""Labelled images to train detectors on, as folders: what the station saw, for people who correct it before they train.

There is one class. Which vehicle a box is stands beside it where the format has room, and in ``boxes.csv`` for all.
"""
