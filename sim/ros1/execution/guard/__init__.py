"""Why an execution ends early: the arm off what is proven clear, or robot or network changed."""
