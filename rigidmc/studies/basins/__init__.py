"""basins"""
