"""The study of the thesis as a folder of static pages, and its figures for print."""
