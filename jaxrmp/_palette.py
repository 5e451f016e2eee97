"""Colours of what is drawn: in figures, in the plots of the viewer's page."""

# Okabe and Ito's palette, told apart with any colour vision; its yellow, too light for lines, is kept for the goal.
BLUE, VERMILLION, GREEN, PURPLE, ORANGE, SKY = "#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9"
BLACK, GOAL, GREY, PALE, WHITE = "#000000", "#F0E442", "#55616B", "#BBBBBB", "#FFFFFF"
SERIES = (BLUE, VERMILLION, GREEN, PURPLE, ORANGE, SKY, BLACK)
