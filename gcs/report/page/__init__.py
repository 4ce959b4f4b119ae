"""One HTML file about a flight that needs nothing else to be read: no network, no script, no font.

``flight_summary`` adds up snapshots, the other parts draw what it holds, ``html`` puts them into one page,
``style`` is its look: the page of a batch has the same.
"""
