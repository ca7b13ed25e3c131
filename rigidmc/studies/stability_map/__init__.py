"""Stability maps: a measure of the motion over two parameters of a scene."""
