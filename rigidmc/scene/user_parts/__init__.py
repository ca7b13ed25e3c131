"""user_parts"""
