"""How high a camera may fly until tags on the vehicles' roofs can no longer be read, and what the product names there.

python -m bench.apriltag [--quick] [--out bench-results/apriltag]
"""
