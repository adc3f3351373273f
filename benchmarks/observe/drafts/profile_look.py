import cProfile,pstats,time
from benchmarks.observe.laser import *
look(profiled(1,"solid"))
m=profiled(1,"solid",size=20.0,px=0.02)
t=time.process_time(); w=time.time()
p=cProfile.Profile(); p.enable(); look(m); p.disable()
print("cpu",time.process_time()-t,"wall",time.time()-w)
pstats.Stats(p).sort_stats("tottime").print_stats(22)
