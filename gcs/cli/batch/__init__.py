"""``gcs batch`` and ``gcs batch report``: many recordings at once, and one page over all of them."""
