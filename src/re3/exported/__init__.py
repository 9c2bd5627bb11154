"""What goes beside an exported network: a card that says all a program must know, and examples."""
