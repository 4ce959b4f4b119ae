"""What the paper reports, as facts. Chen, Du, Wu, Drones 2025, 9(9), 612, doi:10.3390/drones9090612."""

from __future__ import annotations

FIG7_LOW = {"straight": 90.0, "curved": 80.0}
"""Projection without rotation at low noise, %: above 90, about 80."""
FIG7_STEP = {"straight": 1.98, "curved": 1.67}
"""Loss of projection per 0.25 m of σ, %."""
FIG8_LOW = 87.6
"""Topology at low noise, %."""
FIG8_STEP = {"straight": 1.06, "curved": 0.96}
"""Loss of topology per 0.25 of σ, %, as the text has it."""
FALSE_BOX = {"projection": (99.07, 100.00), "topology": (96.53, 98.53), "TTS": (88.43, 45.71)}
"""Precision and FPER, %."""
FIELD = {"projection": (74.20, 75.00), "TTS": (19.50, 82.00)}
"""Precision and FPER, %."""
