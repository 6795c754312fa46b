"""Changes of topology: thin parts that points deny are cut off, tubes that points trace are grown.

May import levelset, motion and what is below them. Start with `search`; `cuts` and `tubes` propose.
"""
