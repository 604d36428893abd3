// Ceres on a BAL file: one run of Levenberg-Marquardt on one thread, told as one JSON document on standard output.
//
//     bundle FILE dense|sparse|iterative [function tolerance] [iterations]
//
// The camera is Snavely's with derivatives by automatic differentiation, the points are eliminated first, and all that
// is not named here is as Ceres sets it. Peak memory is the process's, loading included.

#include <algorithm>
#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <ctime>
#include <fstream>
#include <string>
#include <vector>

#include "ceres/ceres.h"
#include "ceres/rotation.h"
#include "ceres/version.h"

namespace {

constexpr int kCamera = 9, kPoint = 3, kPixel = 2;

// Rotation vector and translation take the world into the camera's frame; it looks along -z.
struct PixelError {
  double u, v;

  template <typename T>
  bool operator()(const T* camera, const T* point, T* error) const {
    T local[3];
    ceres::AngleAxisRotatePoint(camera, point, local);
    for (int k = 0; k < 3; ++k) local[k] += camera[3 + k];
    const T x = -local[0] / local[2], y = -local[1] / local[2];
    const T square = x * x + y * y;
    const T scale = camera[6] * (1.0 + square * (camera[7] + camera[8] * square));
    error[0] = scale * x - u;
    error[1] = scale * y - v;
    return true;
  }
};

struct Observation {
  int camera, point;
  double u, v;
};

struct Scene {
  std::vector<Observation> observations;
  std::vector<double> cameras, points;
};

bool Read(const char* path, Scene* scene) {
  std::FILE* file = std::fopen(path, "r");
  if (file == nullptr) return false;
  int cameras = 0, points = 0, observations = 0;
  bool good = std::fscanf(file, "%d %d %d", &cameras, &points, &observations) == 3;
  if (good) {
    scene->observations.resize(observations);
    scene->cameras.resize(kCamera * cameras);
    scene->points.resize(kPoint * points);
  }
  for (Observation& o : scene->observations)
    good = good && std::fscanf(file, "%d %d %lf %lf", &o.camera, &o.point, &o.u, &o.v) == 4 && o.camera >= 0 &&
           o.camera < cameras && o.point >= 0 && o.point < points;
  for (double& number : scene->cameras) good = good && std::fscanf(file, "%lf", &number) == 1;
  for (double& number : scene->points) good = good && std::fscanf(file, "%lf", &number) == 1;
  std::fclose(file);
  return good;
}

double Megabytes(const char* key) {
  std::ifstream status("/proc/self/status");
  for (std::string line; std::getline(status, line);)
    if (line.rfind(key, 0) == 0) return std::atof(line.c_str() + std::strlen(key)) / 1024.0;
  return 0.0;
}

double Wall() {
  return std::chrono::duration<double>(std::chrono::steady_clock::now().time_since_epoch()).count();
}

double Processor() { return static_cast<double>(std::clock()) / CLOCKS_PER_SEC; }

// Cost and time after the evaluation at the start and after each iteration.
struct Watch : ceres::IterationCallback {
  double wall = Wall(), processor = Processor();
  std::vector<double> costs, times, processor_times;

  ceres::CallbackReturnType operator()(const ceres::IterationSummary& now) override {
    costs.push_back(costs.empty() ? now.cost : std::min(now.cost, costs.back()));
    times.push_back(Wall() - wall);
    processor_times.push_back(Processor() - processor);
    return ceres::SOLVER_CONTINUE;
  }
};

void Print(const char* key, const std::vector<double>& numbers) {
  std::printf("\"%s\": [", key);
  for (size_t k = 0; k < numbers.size(); ++k) std::printf("%s%.12g", k ? ", " : "", numbers[k]);
  std::printf("], ");
}

}  // namespace

int main(int argc, char** argv) {
  if (argc < 3) {
    std::fprintf(stderr, "usage: bundle FILE dense|sparse|iterative [function tolerance] [iterations]\n");
    return 2;
  }
  const std::string solver = argv[2];
  Scene scene;
  if (!Read(argv[1], &scene)) {
    std::fprintf(stderr, "%s: no BAL file\n", argv[1]);
    return 3;
  }
  Watch watch;

  ceres::Problem problem;
  auto* order = new ceres::ParameterBlockOrdering;
  for (const Observation& o : scene.observations) {
    double* camera = &scene.cameras[kCamera * o.camera];
    double* point = &scene.points[kPoint * o.point];
    auto* cost = new ceres::AutoDiffCostFunction<PixelError, kPixel, kCamera, kPoint>(new PixelError{o.u, o.v});
    problem.AddResidualBlock(cost, nullptr, camera, point);
    order->AddElementToGroup(point, 0);
    order->AddElementToGroup(camera, 1);
  }
  ceres::Solver::Options options;
  options.linear_solver_type = solver == "dense"    ? ceres::DENSE_SCHUR
                               : solver == "sparse" ? ceres::SPARSE_SCHUR
                                                    : ceres::ITERATIVE_SCHUR;
  options.preconditioner_type = ceres::SCHUR_JACOBI;  // of the iterative solver
  options.linear_solver_ordering.reset(order);
  options.num_threads = 1;
  options.max_num_iterations = argc > 4 ? std::atoi(argv[4]) : 100;
  options.function_tolerance = argc > 3 ? std::atof(argv[3]) : 1e-6;
  options.logging_type = ceres::SILENT;
  options.callbacks.push_back(&watch);
  ceres::Solver::Summary summary;
  ceres::Solve(options, &problem, &summary);

  std::printf("{\"version\": \"%s\", ", CERES_VERSION_STRING);
  Print("costs", watch.costs);
  Print("times", watch.times);
  Print("processor_times", watch.processor_times);
  std::printf("\"seconds\": %.9g, \"processor\": %.9g, \"megabytes\": %.6g}\n", Wall() - watch.wall,
              Processor() - watch.processor, Megabytes("VmHWM:"));
  return 0;
}
