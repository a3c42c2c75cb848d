"""``surveilnav init``: the files of a real building, from a person's answers or from a file of them.

answers   the questions, as Pydantic models: what each answer may be, and what it is for
asking    asks them in a terminal; a wrong answer is asked again
plans     floor plans and Nav2's maps: what an answer names, and the files that are copied
texts     answers -> the texts of the files
writing   writes all files or none
"""
