"""Looking at and listening to a dataset: `avs3d view`.

`facts` reads what an observation's page shows, `pictures`, `floorplan` and `sound` make its files, `pages` its HTML,
`site` knows every address; `build` writes them all, `live` makes them when they are asked for, `server` answers with
them. `links` keeps all of them within the dataset.
"""
