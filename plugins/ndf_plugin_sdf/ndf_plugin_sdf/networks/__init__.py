"""Described multilayer perceptrons phi(x, y, z): their weights, their description, values and gradients."""
