"""The field suite: generated sessions with real errors, the product and others side by side, goals met or not.

python -m bench.field [--quick] [--seeds tune|report] [--family 9] [--out bench-results/field]
"""
