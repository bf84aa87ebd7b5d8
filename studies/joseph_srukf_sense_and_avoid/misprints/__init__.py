"""Misprints of De Vivo et al., each as a function that computes the printed and the right form."""
