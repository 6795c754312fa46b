"""Is one part of the map shifted against the others, because the patient moved or the reference slipped?

May import motion and what is below it. Start with `search`.
"""
