!> Where a curve begins: at a motion that is solved first, next to another curve, or where a stored one has been; and its ways.
submodule (hb_motion_curve) hb_motion_curve_start
   use hb_accurate_motion, only: solve_to_tolerance
   use hb_bordered, only: bordered_problem_t, new_bordered_problem
   use hb_curve, only: curve_config_t, new_curve
   use hb_curve_conditions, only: set_conditions
   use hb_curve_origin, only: find_direction
   use hb_harmonics, only: harmonics_t, new_of_parity
   use hb_hysteretic_law, only: has_memory
   use hb_motion, only: solve_motion
   use hb_newton, only: solve_newton
   use hb_rung, only: join, put_on_rung, reliable, rung_of
   use hb_scene_problem, only: new_scene_problem
   use hb_scene_symmetry, only: half_of_odd, is_solved_odd
   use hb_solver_types, only: solver_config_t
   use hb_tangent_solver, only: new_tangent_solver, tangent_solver_t
   implicit none

   integer, parameter :: most_corrections = 10
   real(wp), parameter :: run_up = 0.05_wp                            ! of the longest step, to what is expected next
   real(wp), parameter :: farthest = 2.0_wp                           ! from where they leave it, relative to that part
   real(wp), parameter :: first_parts(4) = [0.02_wp, 0.1_wp, 0.3_wp, 0.005_wp]   ! of the motion: others where they leave a curve

contains

   module procedure motion_curve_begin
      real(wp), allocatable :: further(:), unknowns(:)
      type(rung_t) :: lowest, rung
      logical :: is_new

      self%request = request
      self%watch => watch
      if (allocated(request%origin)) then
         call begin_at_origin(self, scene, document, result, error)
         return
      end if
      if (scene%accuracy%is_on) then
         scene%chain%is_on = .false.                                  ! the point has no neighbour, and is none
         call solve_to_tolerance(scene, result, error, rung, watch=watch, judge=judge)
         if (allocated(rung%unknowns) .and. scene%accuracy%grows_set) then
            lowest = rung
            call join(lowest, scene%harmonics, is_new)                ! without even tuples no symmetry is seen to break
            if (is_new) call solve_to_tolerance(scene, result, error, rung, lowest, watch, judge)
         end if
         if (allocated(rung%unknowns)) unknowns = rung%unknowns
      else
         call solve_motion(scene, result, error, unknowns=unknowns, watch=watch, judge=judge)
         rung = rung_of(scene)
      end if
      self%is_done = allocated(error) .or. .not. allocated(unknowns)
      if (any(result%status == [outcome%marched, outcome%several])) then
         result%status = outcome%stalled                              ! a motion, but no point of a curve
         result%message = "a curve starts from a balance; "//result%message
      end if
      if (any(scene%tones%is_unknown) .and. scene%accuracy%is_on .and. .not. self%is_done) then
         self%is_done = estimate_of(result) >= reliable
         if (self%is_done) result%message = "no set that is allowed holds this motion: it may have other tones, or none"
      end if
      if (self%is_done) return
      further = [pack(result%frequency, scene%tones%is_unknown)]
      if (scene%normal_mode%is_asked) further = [further, pack(result%artificial_damping, scene%tones%is_unknown)]
      further = [further, request%start]
      call prepare(self, scene, document, further, rung, error)
      self%is_done = allocated(error)
      if (self%is_done) return
      self%x_first = [unknowns(:self%problem%n_unknowns), further]
      call self%set_out(error)
      if (.not. allocated(error)) call self%note_met(self%x_first, self%first_rung)
      self%n_told = 1
      result%curve = curve_place_t(curve_kind%start, request%start, 0.0_wp, 0, self%state())
      if (scene%accuracy%is_on) then
         result%curve%tuples = rung%set%tuples
         result%curve%n_samples = rung%n_samples
      end if
      self%is_done = allocated(error) .or. self%n_told >= request%n_points
   end procedure motion_curve_begin

   !> Begins where the curve leaves another one, a small way along it: at the very point the tangent has no inverse.
   subroutine begin_at_origin(self, scene, document, result, error)
      class(motion_curve_t), intent(inout), target :: self
      type(scene_t), intent(in) :: scene
      type(document_t), intent(in) :: document
      type(motion_result_t), intent(inout) :: result
      type(error_t), allocatable, intent(out) :: error
      logical :: is_found

      call prepare(self, scene, document, self%request%origin%further, self%request%origin%rung, error)
      self%is_done = allocated(error)
      if (self%is_done) return
      call find_first(self, is_found)
      if (.not. is_found) then
         result%status = outcome%stalled
         result%message = "next to the point where it leaves the other curve no motion was found"
         self%is_done = .true.
         return
      end if
      if (scene%accuracy%is_on) call self%settle(self%x_first, self%first_direction, error)
      self%is_done = allocated(error)
      if (self%is_done) return
      self%first_rung = self%rung
      call self%set_out(error)
      if (allocated(error)) return
      call self%put_start()
      call self%tell(self%waiting(1), result, error)
      self%first_waiting = 2
      self%n_told = 1
      self%is_done = allocated(error) .or. self%n_told >= self%request%n_points
   end subroutine begin_at_origin

   !> The first motion of a curve that leaves another one, and the direction there.
   subroutine find_first(self, is_found)
      class(motion_curve_t), intent(inout), target :: self
      logical, intent(out) :: is_found
      real(wp) :: across(self%problem%n_unknowns), joined
      real(wp), allocatable :: from(:)
      integer :: i
      logical :: is_possible

      associate (origin => self%request%origin, n => self%problem%n_unknowns, n_which => size(self%which))
         self%x_first = [origin%u, origin%further]
         call self%move(self%x_first, is_possible)
         is_found = is_possible
         if (.not. is_found) return
         call find_direction(self%problem, origin, joined, across, is_found)
         if (.not. is_found) return
         if (origin%is_torus) self%x_first(n + n_which - 1) = joined
         across = across/norm2(across/self%weights)*norm2(self%x_first(:n)/self%weights)
         self%first_direction = [across, spread(0.0_wp, 1, n_which)]
      end associate
      from = self%x_first
      do i = 1, size(first_parts)                                     ! forces with kinks may have none just beside
         self%x_first = from + first_parts(i)*self%first_direction
         call self%find_on_plane(self%x_first, self%first_direction, is_found)
         if (is_found) is_found = norm2((self%x_first - from)/units_at(self, from)) <= farthest*first_parts(i)
         if (is_found) exit
      end do
   end subroutine find_first

   !> Units of length by one motion.
   function units_at(self, x) result(units)
      class(motion_curve_t), intent(in) :: self
      real(wp), intent(in) :: x(:)
      real(wp) :: units(size(x))

      units = [self%weights*max(least_motion, norm2(x(:self%problem%n_unknowns)/self%weights)), &
               self%problem%parameter_scales(self%which)]
   end function units_at

   module procedure motion_curve_find_on_plane
      type(bordered_problem_t) :: bordered
      type(report_t) :: report
      type(solver_config_t) :: corrector
      real(wp) :: units(size(x))
      logical :: is_possible

      call self%move(x, is_possible)
      is_found = is_possible
      if (.not. is_found) return
      units = units_at(self, x)
      call new_bordered_problem(bordered, self%problem, self%which, spread(direction/units**2, 2, size(self%which)), &
                                spread(0.0_wp, 1, size(self%which)))
      self%curve%x = x
      self%curve%problem = bordered
      call set_conditions(self%problem, self%which, self%curve, self%weights)
      self%curve%problem%values = matmul(x, self%curve%problem%forms)
      call self%curve%problem%rescale()
      corrector = self%problem%scene%solver
      associate (u => x(:self%problem%n_unknowns))
         self%unevenness = self%problem%unevenness(u)
         self%is_uneven = 10.0_wp*self%unevenness > corrector%tolerance
         corrector%tolerance = max(corrector%tolerance, 2.0_wp*self%problem%rounding_level(u), 10.0_wp*self%unevenness)
      end associate
      corrector%max_iterations = 2*most_corrections
      self%slack = 1.0_wp
      do
         call solve_newton(self%curve%problem, corrector, x, report)
         is_found = report%status == outcome%converged
         if (is_found .or. .not. self%is_uneven .or. self%slack >= most_slack) exit
         self%slack = 10.0_wp*self%slack
         corrector%tolerance = 10.0_wp*corrector%tolerance
         x = self%curve%x
      end do
   end procedure motion_curve_find_on_plane

   module procedure motion_curve_begin_next_to

      self%request = request
      self%watch => watch
      self%way = 1
      is_found = .false.
      if (allocated(self%waiting)) deallocate (self%waiting, self%origins, self%met)
      associate (n => size(place%state)/2)
         call prepare(self, scene, document, place%state(n - self%n_further(scene) + 1:n), rung_of(scene, place), error)
         if (allocated(error)) return
         associate (x => place%state(:n), direction => place%state(n + 1:))
            self%x_first = x - run_up*request%longest_step*direction/norm2(direction/units_at(self, x))
            self%first_direction = direction
         end associate
      end associate
      call self%find_on_plane(self%x_first, self%first_direction, is_found)
      if (is_found) call self%set_out(error)
      self%first_waiting = 1
   end procedure motion_curve_begin_next_to

   module procedure motion_curve_go_on_from
      type(motion_result_t) :: result
      type(rung_t) :: rung
      integer :: i, n

      self%request = request
      self%watch => watch
      n = n_entries(stored(1)%state, 3)
      call prepare(self, scene, document, stored(1)%state(n - self%n_further(scene) + 1:n), rung_of(scene, stored(1)), error)
      self%is_done = allocated(error)
      if (self%is_done) return
      self%x_first = stored(1)%state(:n)
      call self%note_met(self%x_first, self%first_rung)
      if (allocated(request%origin)) self%first_direction = stored(1)%state(n + 1:2*n)
      do i = 2, size(stored)
         rung = rung_of(scene, stored(i))
         n = rung%set%n_coefficients*self%problem%balance%n_dofs + self%n_further(scene)
         if (stored(i)%kind == curve_kind%branch .and. stored(i)%branch == 0 .and. request%switches) &
            call self%note_origin(stored(i)%state(:2*n), rung)
         if (stored(i)%kind == curve_kind%start .and. stored(i)%branch > size(self%origins)) &
            call self%note_apart(stored(i)%state(:n), rung)
         call self%note_met(stored(i)%state(:n), rung)
      end do
      associate (last => stored(size(stored)))
         self%way = 2*last%branch + merge(2, 1, last%length < 0.0_wp .or. &
                                          (last%branch > 0 .and. count(stored%kind == curve_kind%start .and. &
                                                                       stored%branch == last%branch) > 1))
         n = n_entries(last%state, 3)
         call self%set_out(error)
         if (allocated(error)) return
         self%n_told = size(stored)
         self%length = abs(last%length)
         if (scene%accuracy%is_on) then
            call self%put_on(rung_of(scene, last), error)
            if (allocated(error)) return
            call self%make_curve(last%state(:n), last%state(n + 1:2*n))
            call self%carry_start()
         end if
         self%curve%x = last%state(:n)
         self%curve%direction = last%state(n + 1:2*n)
         self%curve%step = last%state(2*n + 1)
         self%curve%orientation = last%state(2*n + 2)
         self%largest = last%state(2*n + 3)
         call note_extremes(self, stored)
      end associate
      call self%renew()
      call self%look_here()
      associate (last => stored(size(stored)))
         if (scene%accuracy%is_on .and. last%kind == curve_kind%regular) then
            call self%describe(waiting_t(last%kind, 0.0_wp, self%curve%x), result, error)
            self%estimate = estimate_of(result)
         end if
      end associate
      self%is_done = self%n_told >= request%n_points
   end procedure motion_curve_go_on_from

   !> Notes the folds and peaks of stored points that are on the way of the last one.
   subroutine note_extremes(self, stored)
      class(motion_curve_t), intent(inout) :: self
      type(curve_place_t), intent(in) :: stored(:)
      integer :: i, n, response

      n = size(self%request%peaks)
      associate (last => stored(size(stored)))
         do i = size(stored), 2, -1
            if (stored(i)%kind == curve_kind%start .or. stored(i)%length*last%length < 0.0_wp) exit
            if (.not. any(stored(i)%kind == [curve_kind%fold, curve_kind%peak])) cycle
            response = merge(min(n, 1), 0, stored(i)%kind == curve_kind%peak)
            if (n > 1) response = nint(stored(i)%state(size(stored(i)%state)))
            self%extremes_told = [self%extremes_told, extreme_told_t(response, abs(stored(i)%length))]
         end do
      end associate
   end subroutine note_extremes

   !> Makes the curve ready to begin on a set and a grid.
   subroutine prepare(self, scene, document, further, rung, error)
      class(motion_curve_t), intent(inout), target :: self
      type(scene_t), intent(in) :: scene
      type(document_t), intent(in) :: document
      real(wp), intent(in) :: further(:)                              !! unknowns beside those of the balance, at the start
      type(rung_t), intent(in) :: rung                                !! of its first motion
      type(error_t), allocatable, intent(out) :: error
      integer :: i

      self%scene = scene
      self%document = document
      self%further = further
      self%first_rung = rung_t(rung%set, rung%n_samples)
      if (.not. allocated(self%request%values)) allocate (self%request%values(0))
      if (allocated(self%request%others)) then
         do i = 1, size(self%request%others)
            if (all(abs(self%request%values - self%request%others(i)) > 0.0_wp)) &
               self%request%values = [self%request%values, self%request%others(i)]
         end do
      end if
      if (.not. allocated(self%request%peaks)) allocate (self%request%peaks(0))
      allocate (self%waiting(0), self%origins(0), self%met(0))
      self%first_sense = sign(1.0_wp, self%request%to - self%request%start)
      if (.not. abs(self%request%to - self%request%start) > 0.0_wp) self%first_sense = -sign(1.0_wp, self%first_sense)
      call self%put_on(self%first_rung, error)
   end subroutine prepare

   module procedure motion_curve_put_on
      type(scene_t) :: found
      integer :: i, n_unknown

      found = self%scene
      associate (tones => found%tones)
         n_unknown = count(tones%is_unknown)
         self%which = pack([(i, i=1, tones%n_tones)], tones%is_unknown)
         tones%omega(self%which) = self%further(:n_unknown)
         if (found%normal_mode%is_asked) self%which = [self%which, tones%n_tones + self%which]
      end associate
      if (found%accuracy%is_on) then
         call put_on_rung(found, self%scene, rung, error)
         if (allocated(error)) return
         found%certificate%is_on = .true.
         found%certificate%truncation = found%accuracy%tolerance
         found%certificate%aliasing = found%accuracy%tolerance
         call self%problem%destroy()
      end if
      call new_scene_problem(self%problem, found, self%document, self%request%moving, self%request%start, &
                             self%request%available_memory, error)
      if (allocated(error)) return
      self%rung = rung_t(rung%set, rung%n_samples)
      self%which = [self%which, self%problem%own]
      self%weights = self%problem%x_scale
      call make_odd_problem(self, found, error)
      if (allocated(error)) return
      do i = 1, size(self%request%peaks)
         associate (peak => self%request%peaks(i))
            peak%column = self%problem%balance%stiffness%coordinates%number_of(peak%dof)
         end associate
      end do
   end procedure motion_curve_put_on

   !> The problem of odd motions alone on the set at hand, where a given frequency moves and the equations are odd: other values may
   !> break the symmetry. Sliders may be held off their middle by odd motions, whose forces then are not odd.
   subroutine make_odd_problem(self, scene, error)
      class(motion_curve_t), intent(inout), target :: self
      type(scene_t), intent(in) :: scene                              !! on the set at hand
      type(error_t), allocatable, intent(out) :: error
      type(harmonics_t) :: odd
      type(scene_t) :: reduced
      integer :: h, i, m, n
      integer, allocatable :: rows(:)

      if (allocated(self%odd_problem)) then
         call self%odd_problem%destroy()
         deallocate (self%odd_problem)
      end if
      if (.not. (self%problem%moves_frequency .and. is_solved_odd(scene)) .or. has_memory(scene%laws) .or. &
          any(scene%tones%is_unknown)) return
      call new_of_parity(odd, scene%harmonics, 1, error)
      if (allocated(error) .or. odd%n_harmonics == scene%harmonics%n_harmonics) return
      reduced = scene
      call put_on_rung(reduced, scene, rung_t(odd, scene%torus%n_samples), error)
      if (allocated(error)) return
      reduced%torus = half_of_odd(scene)
      allocate (self%odd_problem)
      call new_scene_problem(self%odd_problem, reduced, self%document, self%request%moving, self%request%start, &
                             self%request%available_memory, error)
      associate (set => scene%harmonics)
         allocate (rows(0))
         do h = 1, set%n_harmonics
            if (modulo(sum(set%tuples(:, h)), 2) == 0) cycle
            rows = [rows, set%cos_at(h), pack([set%sin_at(h)], [set%sin_at(h) > 0])]
         end do
         n = self%problem%n_unknowns
         m = size(self%which)
         self%odd_places = [((i + rows(h), h=1, size(rows)), i=0, n - 1, set%n_coefficients), (n + i, i=1, m)]
      end associate
   end subroutine make_odd_problem

   module procedure motion_curve_keep_symmetry
      real(wp), parameter :: rounding = 1.0e-10_wp                    ! even part that counts as none

      associate (curve => self%curve)
         if (allocated(curve%part)) deallocate (curve%part)
         if (.not. allocated(self%odd_problem)) return
         if (even_part_of(curve%x) > rounding .or. even_part_of(curve%direction) > rounding) return
         allocate (curve%part)
         curve%kept = self%odd_places
         call new_bordered_problem(curve%part, self%odd_problem, self%which, curve%problem%forms(curve%kept, :), &
                                   curve%problem%values)
      end associate

   contains

      pure real(wp) function even_part_of(x)
         real(wp), intent(in) :: x(:)
         real(wp) :: odd(size(x))

         odd = 0.0_wp
         odd(self%odd_places) = x(self%odd_places)
         even_part_of = norm2((x - odd)/self%curve%units)/norm2(x/self%curve%units)
      end function even_part_of
   end procedure motion_curve_keep_symmetry

   module procedure motion_curve_make_curve
      type(bordered_problem_t) :: bordered
      type(curve_config_t) :: config
      type(solver_config_t) :: corrector
      real(wp) :: forms(size(x), size(self%which)), units(size(x))

      config%longest_step = self%request%longest_step
      config%first_step = 0.1_wp*config%longest_step
      config%shortest_step = 1.0e-6_wp*config%longest_step
      config%kink_step = 1.0e-4_wp*config%longest_step
      config%angle = 0.12_wp
      config%growth = 2.0_wp
      corrector = self%problem%scene%solver
      corrector%max_iterations = most_corrections
      corrector%line_search = .false.
      forms = 0.0_wp
      forms(:, size(self%which)) = direction
      call new_bordered_problem(bordered, self%problem, self%which, forms, 0.0_wp*forms(1, :))
      self%curve%x = x
      self%curve%problem = bordered
      call self%renew()
      call set_conditions(self%problem, self%which, self%curve, self%weights)
      bordered = self%curve%problem
      units = self%curve%units
      if (self%is_uneven) config%shortest_step = 1.0e-3_wp*config%longest_step   ! no step is as short as to help
      call new_curve(self%curve, bordered, x, direction, units, config, corrector)
      call self%keep_symmetry()
   end procedure motion_curve_make_curve

   module procedure motion_curve_set_out
      type(rung_t) :: rung
      real(wp), allocatable :: direction(:)
      logical :: is_possible, is_turning

      rung = self%first_rung
      if (self%way > 2) rung = self%origins((self%way - 1)/2)%rung
      if (self%scene%accuracy%is_on) call self%put_on(rung, error)
      if (allocated(error)) return
      self%x_start = self%x_first
      allocate (direction(size(self%x_first)), source=0.0_wp)
      direction(size(direction)) = self%first_sense*self%sense()
      if (allocated(self%first_direction)) direction = self%first_direction
      is_turning = .false.
      if (self%way > 2) then
         associate (origin => self%origins((self%way - 1)/2))
            self%x_start = origin%x
            is_turning = .not. origin%is_apart
            direction = [0.0_wp*origin%x(:size(origin%x) - 1), self%first_sense*self%sense()]
            if (is_turning) direction = origin%direction
         end associate
      end if
      self%has_collapsed = .false.
      self%length = 0.0_wp
      self%extremes_told = [extreme_told_t ::]
      self%estimate = huge(1.0_wp)
      self%largest = least_motion
      call self%move(self%x_start, is_possible)
      self%slack = 1.0_wp
      self%unevenness = self%problem%unevenness(self%x_start(:self%problem%n_unknowns))
      self%is_uneven = 10.0_wp*self%unevenness > self%problem%scene%solver%tolerance
      call self%make_curve(self%x_start, direction)
      if (is_turning) then
         call turn_off(self, direction)
         self%curve%direction = self%sense()*direction
         self%curve%orientation = 0.0_wp                              ! not known where the determinant vanishes
         self%curve%status = outcome%pending
         call self%keep_symmetry()
      end if
      self%direction_start = self%curve%direction
      self%outset = origin_t(x=self%x_start, direction=self%direction_start, rung=rung)
      call self%renew()
      call self%look_here()
   end procedure motion_curve_set_out

   !> At a branch point the tangent bordered by the direction has a null vector: the direction of the other curve across this one,
   !> by inverse iteration. Its sense, which rounding would choose, is that of its first large entry.
   subroutine turn_off(self, direction)
      class(motion_curve_t), intent(inout), target :: self
      real(wp), intent(inout), contiguous :: direction(:)             !! of the curve; of the other one
      type(tangent_solver_t) :: solver
      real(wp) :: along(size(direction)), next(size(direction))
      integer :: i
      integer, parameter :: n_rounds = 3
      real(wp), parameter :: large = 0.6_wp                           ! of the largest
      real(wp), parameter :: nearby = 1.0e-9_wp                       ! where the tangent is not singular to the last digit
      logical :: is_singular

      associate (curve => self%curve)
         along = direction/curve%units
         along = along/norm2(along)
         call curve%put_plane(curve%x, direction, 0.0_wp)
         next = curve%units*across(cos([(real(i, wp), i=1, size(next))]), along)
         call new_tangent_solver(solver, curve%problem, curve%x, is_singular)
         if (is_singular) call new_tangent_solver(solver, curve%problem, curve%x + nearby*direction, is_singular)
         if (is_singular) return
         do i = 1, n_rounds
            next = next/curve%units*curve%problem%r_scale             ! as a residual
            call solver%solve(curve%problem, next, is_singular)
            next = curve%units*across(next/curve%units, along)
         end do
         associate (scaled => next/curve%units)
            i = findloc(abs(scaled) > large*maxval(abs(scaled)), .true., dim=1)
            direction = sign(1.0_wp, scaled(i))*next
         end associate
      end associate

   contains

      !> The part of a vector across another one, of length 1.
      pure function across(vector, other) result(part)
         real(wp), intent(in) :: vector(:), other(:)
         real(wp) :: part(size(vector))

         part = vector - dot_product(vector, other)*other
         part = part/norm2(part)
      end function across
   end subroutine turn_off

   module procedure motion_curve_put_start

      if (allocated(self%waiting)) deallocate (self%waiting)
      allocate (self%waiting(1))
      self%waiting(1)%kind = curve_kind%start
      self%waiting(1)%x = self%x_start
      self%first_waiting = 1
   end procedure motion_curve_put_start
end submodule hb_motion_curve_start
