// A program that drives the delivered StepBlocks.cs as an engine does: the library tick by tick,
// and the component with its servo.
using System;
using System.Globalization;
using System.Reflection;
using System.Threading;
using StepBlocksUnity;

static class Drive
{
    static readonly CultureInfo Plain = CultureInfo.InvariantCulture;

    static int Main(string[] words)
    {
        if (words[0] == "ticks") return Ticks(words[1], words[2]);
        if (words[0] == "states") return States(words[1], words[2]);
        return words[0] == "failing" ? Failing(words[1], words[2]) : Component(words[1], words[2]);
    }

    // One line of x, y, z on the standard input for each tick of a millisecond; one line of the
    // output back.
    static int Ticks(string file, string block)
    {
        IntPtr world = Native.sb_create();
        if (Native.sb_abi_version() != Native.AbiVersion) return 1;
        if (Native.sb_load(world, Native.Text(file)) < 1) return 1;
        Native.sb_configure(world, (int)Setting.Rise, 0.0);
        Native.sb_choose(world, Native.sb_find(world, Native.Text(block)));
        double[] still = new double[3];
        for (string line = Console.ReadLine(); line != null; line = Console.ReadLine())
        {
            string[] parts = line.Split(' ');
            double[] hand = new double[3];
            for (int i = 0; i < 3; ++i) hand[i] = double.Parse(parts[i], Plain);
            Output o;
            Native.sb_tick(world, hand, still, 1e-3, out o);
            double[] told =
            {
                o.forceX, o.forceY, o.forceZ, o.ring, o.pull, o.tipX, o.tipZ, o.releaseForce,
                o.releaseEnergy
            };
            string numbers = string.Join(" ", Array.ConvertAll(told, Write));
            Console.WriteLine(
                numbers + " " + o.events + " " + o.faults + " " + o.touching + " " + o.block);
        }
        Native.sb_destroy(world);
        return 0;
    }

    // One line of x, z, dt on the standard input for each tick; force, state and release back.
    static int States(string file, string block)
    {
        IntPtr world = Native.sb_create();
        if (Native.sb_load(world, Native.Text(file)) < 1) return 1;
        Native.sb_choose(world, Native.sb_find(world, Native.Text(block)));
        double[] still = new double[3];
        for (string line = Console.ReadLine(); line != null; line = Console.ReadLine())
        {
            double[] given = Array.ConvertAll(line.Split(' '), Read);
            Output o;
            Native.sb_tick(world, new[] { given[0], 0.0, given[1] }, still, given[2], out o);
            double[] told = { o.forceX, o.forceZ, o.state, o.releaseForce, o.events };
            Console.WriteLine(string.Join(" ", Array.ConvertAll(told, Write)));
        }
        Native.sb_destroy(world);
        return 0;
    }

    static double Read(string word)
    {
        if (word == "nan") return double.NaN;
        if (word == "inf") return double.PositiveInfinity;
        if (word == "-inf") return double.NegativeInfinity;
        return double.Parse(word, Plain);
    }

    // A hand that keeps its load is pulled over the edge while the servo of the component runs, by
    // a time of its own: how busy the machine is does not matter.
    static int Component(string folder, string block)
    {
        UnityEngine.Application.streamingAssetsPath = folder;
        var one = new StepBlocks { block = block, forceLimit = 5.0, rise = 0.01 };
        double x = -2e-4, z = 3e-4, given = -1.0, time = 0.0;
        int ticks = 0;
        one.Seconds = () => time += 1e-4;
        one.ReadHand = (hand, velocity) => {
            hand[0] = x;
            hand[1] = 0.0;
            hand[2] = z;
        };
        one.WriteForce = (fx, fy, fz) => {
            z += Math.Max(Math.Min((fz - 0.3) / 9.81e3, 1e-4), -1e-5);
            if (z < 1e-4 && x < 1e-4) x += 2e-7;
            Interlocked.Increment(ref ticks);
            given = Math.Sqrt(fx * fx + fy * fy + fz * fz);
        };
        Call(one, "Start");
        while (one.Releases == 0 && Volatile.Read(ref ticks) < 200000) Thread.Sleep(1);
        string place = one.Tip.x.ToString("R", Plain);
        Console.WriteLine(one.Releases + " " + Write(one.ReleaseForce) + " " + place);
        Call(one, "OnDestroy");
        Console.WriteLine(Write(given));
        return 0;
    }

    // A hand rests on the lower face until its device fails; then a block that is not there is
    // asked for.
    static int Failing(string folder, string block)
    {
        UnityEngine.Application.streamingAssetsPath = folder;
        var one = new StepBlocks { block = block, rise = 0.0 };
        double most = 0.0, given = -1.0, time = 0.0;
        one.Seconds = () => time += 1e-4;
        one.ReadHand = (hand, velocity) => {
            if (most > 0.0) throw new InvalidOperationException("the cable is out");
            hand[0] = -2e-4;
            hand[2] = 0.0;
        };
        one.WriteForce = (fx, fy, fz) => {
            given = Math.Sqrt(fx * fx + fy * fy + fz * fz);
            most = Math.Max(most, given);
        };
        Call(one, "Start");
        DateTime end = DateTime.UtcNow.AddSeconds(60.0);
        while (given != 0.0 && DateTime.UtcNow < end) Thread.Sleep(20);
        Console.WriteLine(Write(most) + " " + Write(given));
        try
        {
            one.Choose("step-999");
        }
        catch (ArgumentException problem)
        {
            Console.Error.WriteLine(problem.Message);
        }
        Call(one, "OnDestroy");
        return 0;
    }

    static string Write(double value)
    {
        return value.ToString("R", Plain);
    }

    static void Call(object one, string name)
    {
        const BindingFlags own = BindingFlags.Instance | BindingFlags.NonPublic;
        one.GetType().GetMethod(name, own).Invoke(one, null);
    }
}
