"""One HTML file about a flight that needs nothing else to be read: no network, no script, no font.

``flight_summary`` adds up snapshots, the other parts draw what it holds, and ``document`` puts them into one page.
"""
