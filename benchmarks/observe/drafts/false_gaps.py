import sys; pass
from gate3 import *
import registration.inspection.see as see_
orig=see_.learned; keep={}
def fl(*a,**k):
    keep['L']=orig(*a,**k); return keep['L']
see_.learned=fl
kind,ink=sys.argv[1:3]
for seed in range(4):
    rng=np.random.default_rng((seed,["single","stack","embedded","laser"].index(kind),["pale","dark","dyed","clear","milky"].index(ink)))
    S=scene(kind,ink,rng,{'gaps':[.25,.5,1.0]} if seed%2 else {})
    f=see(S,kind); L=keep['L']; w=L.drawn.ways
    ts,ta,tv=S.truth['share']
    print("seed",seed,"true shift",np.round(S.truth['shift'],3),"found",round(L.shift.dx_mm,3),round(L.shift.dy_mm,3),"odd",L.odd,"noise",np.round([L.noise.full.min(),L.noise.full.max(),L.noise.bare.min()],3),"tie",round(L.noise.tie,2),"width",w.width[0],"old",L.drawn.old.mean(),"lines",len(np.unique(w.stroke)), "planted",[(int(a),round(b,2),round(c,2)) for a,b,c in S.truth['gaps']])
    for g in f.gaps:
        own=(ts==g.stroke)&(ta>=g.from_mm)&(ta<=g.to_mm)
        tru=tv[own]
        r=(w.stroke==g.stroke)&(w.along>g.from_mm)&(w.along<g.to_mm)
        print("  gap",g.stroke,round(g.from_mm,2),round(g.to_mm,2),"p",f"{g.p_value:.1e}","true share",np.round(tru.mean(),2) if own.any() else None,"len",round(w.along[w.stroke==g.stroke].max(),2),"shares",np.round(np.median(L.shares.share[r]),2),"hid",(~L.shown[r]).mean().round(2))
