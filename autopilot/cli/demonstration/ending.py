"""x"""
def end(*a): return {}
