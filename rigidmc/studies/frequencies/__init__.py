"""frequencies"""
