"""linearise"""
