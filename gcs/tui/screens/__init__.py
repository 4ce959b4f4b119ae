"""What is laid over the panes: help, questions, orders."""
