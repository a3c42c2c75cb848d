"""Episodes, baselines and tables: the services' cores composed in one process, without a bus.

play/       one search: what robot and cameras see, the steps, the planner ``sp``
policies/   ways to search: ours, the paper to the letter, baselines, the bound
dataset/    scenes, cameras and episodes (the paper's section III)
runner/     plays a split, keeps a row a search, sums up
tables/     which runs each table compares (the paper's section V), the pages
studies/    parts measured by themselves
canary      the golden run
"""
