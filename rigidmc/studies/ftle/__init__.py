"""ftle"""
