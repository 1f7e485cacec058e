!> A marched motion to an accuracy: the tuples that it has are found in its record.
!>
!> Scenes are marched with many candidates for a set, to all of which the record is fitted (hb_line_fit); kept are those that
!> matter. What the kept series leaves of the record where the fit has not seen it is the estimated error. Either the scene is
!> marched before any balance is tried, from rest, or from where the ladder of the balance ends above the tolerance: its motion
!> is then nearly steady from the beginning.
module hb_march_to_tolerance
   use hb_advice, only: rounded
   use hb_amplitudes, only: as_amplitudes
   use hb_coordinates, only: coordinates_t
   use hb_error, only: error_t
   use hb_first_way, only: first_way, march_counts_t, march_is_cheaper
   use hb_harmonics, only: harmonics_t, new_harmonics
   use hb_kinds, only: wp
   use hb_law, only: hold_t
   use hb_marched_result, only: guess_from, keep_marched
   use hb_modes, only: slowest_decay
   use hb_motion, only: solve_motion, status_of_ended
   use hb_motion_result, only: motion_result_t
   use hb_outcome, only: outcome
   use hb_refinement, only: refinable_t, refine
   use hb_rung, only: degree_of, distance, estimate_of, is_rigid, put_on_rung, put_on_set, reliable, rung_t
   use hb_scene, only: scene_t, share_of_marched
   use hb_scene_coordinates, only: coordinates_of
   use hb_stability, only: stability_method
   use hb_structure, only: most_dense, structure_t
   use hb_text, only: to_text
   use hb_time_domain, only: settled_t
   use hb_torus, only: samples_for
   use hb_tuple_choice, only: largest_places, lowest_order, new_lowest_set
   use hb_watch, only: verdict, verdict_on_work, work_is_over
   implicit none
   private
   public :: loaded_tuples, march_from_balance, march_to_tolerance, marches_first

   integer, parameter :: candidates_of_kept = 4                       ! at most, for each place of a set
   real(wp), parameter :: fall = 0.7_wp                               ! power of the tolerance with which orders of candidates grow
   real(wp), parameter :: fall_of_one_tone = 0.4_wp                   ! likewise: a larger box costs little then
   real(wp), parameter :: safety = 3.0_wp                             ! of estimates: what is farther apart is another motion
   real(wp), parameter :: nearly = 0.9_wp                             ! of the tolerance: the error at which a march ends
   real(wp), parameter :: share_of_steps = 1.0e-4_wp                  ! of that: tolerance of the steps
   real(wp), parameter :: share_of_tail = 0.3_wp                      ! of that error, in tuples that are not kept

   !> A motion found by time integration whose candidates for a set are refined.
   type, extends(refinable_t) :: refined_record_t
      type(scene_t), pointer :: scene => null()
      type(scene_t) :: here                                           ! the same on the candidates tried last
      type(coordinates_t) :: coordinates
      type(harmonics_t) :: candidates
      integer :: order = 1                                            ! of their box
      integer :: room = 0                                             ! tuples of a set
      integer :: n_found = 0                                          ! motions
      real(wp) :: work = 0.0_wp, most_work = 0.0_wp
      type(settled_t) :: settled                                      ! what is said of the best motion, else of the first candidates
      type(motion_result_t) :: result
      type(rung_t) :: found
      logical :: is_ended = .false.                                   ! no box will do better
   contains
      procedure :: solve => refined_record_solve
      procedure :: choose => refined_record_choose
      procedure :: is_accurate => refined_record_is_accurate
      procedure :: is_over => refined_record_is_over
   end type refined_record_t

contains

   !> Whether marching comes before the balance: asked for, or cheaper by counts.
   logical function marches_first(scene)
      type(scene_t), intent(in) :: scene
      real(wp), parameter :: largest_tolerance = 1.0e-3_wp            ! above it the balance is cheaper in any case
      type(hold_t) :: hold
      type(march_counts_t) :: counts
      type(structure_t) :: structure
      integer :: i

      marches_first = scene%first_way == first_way%march
      if (scene%first_way /= first_way%auto .or. scene%tones%n_tones /= 1 .or. any(scene%tones%is_unknown)) return
      if (.not. is_rigid(scene) .or. .not. scene%accuracy%grows_set .or. size(scene%accuracy%outputs) > 0) return
      if (scene%accuracy%tolerance > largest_tolerance .or. scene%structure%n_dofs > most_dense .or. scene%chain%is_on) return
      structure = scene%structure
      call structure%unpack()
      counts%n_dofs = structure%n_dofs
      counts%n_coordinates = size(scene%laws)
      counts%max_harmonics = scene%accuracy%max_harmonics
      counts%tolerance = scene%accuracy%tolerance
      counts%omega = scene%tones%omega(1)
      do i = 1, size(scene%laws)
         if (.not. scene%laws(i)%law%is_multiplier) cycle
         hold = scene%laws(i)%law%hold()
         counts%has_walls = counts%has_walls .or. hold%is_wall
      end do
      counts%decay = slowest_decay(structure%mass, structure%damping, structure%stiffness)
      counts%fastest = maxval([(sqrt(abs(structure%stiffness(i, i))/max(abs(structure%mass(i, i)), tiny(1.0_wp))), &
                                i=1, structure%n_dofs)])
      marches_first = march_is_cheaper(counts)
   end function marches_first

   !> Marches from rest or the `&start` amplitudes. Not done where that finds no motion.
   subroutine march_to_tolerance(scene, result, is_done)
      type(scene_t), intent(in) :: scene
      type(motion_result_t), intent(inout) :: result
      logical, intent(out) :: is_done
      type(motion_result_t) :: marched
      type(rung_t) :: found
      type(settled_t) :: settled

      is_done = .false.
      if (.not. can_march(scene)) return
      marched%march_work = result%march_work
      call march(scene, settled, marched, found)
      is_done = work_is_over() .or. settled%status /= outcome%pending
      if (.not. is_done) then
         if (allocated(settled%message) .and. allocated(result%message)) result%message = settled%message//"; "//result%message
         return
      end if
      marched%is_marched_first = result%work <= 0.0_wp
      marched%work = marched%work + result%work
      marched%status = settled%status
      if (allocated(marched%coefficients)) marched%status = status_within(scene, settled, marched)
      if (work_is_over()) marched%status = status_of_ended()
      result = marched
   end subroutine march_to_tolerance

   !> Marches from the motion in which the ladder has ended above the tolerance, and takes what that gives where it is the same
   !> motion to the tolerance, or at least nearer to it. The result is else what it was, and says what marching has found.
   subroutine march_from_balance(scene, result, top)
      type(scene_t), intent(in) :: scene
      type(motion_result_t), intent(inout) :: result                  !! of the ladder, `truncated`
      type(rung_t), intent(in) :: top                                 !! its last rung
      type(motion_result_t) :: marched
      type(rung_t) :: found
      type(scene_t) :: from
      type(settled_t) :: settled
      real(wp) :: apart, estimate, estimate_before
      logical :: is_there

      if (.not. (scene%solver%rescue .and. scene%solver%rescue_by_march .and. can_march(scene))) return
      if (allocated(result%output_estimate)) return                   ! of outputs marching knows nothing
      call start_on(scene, top, from, is_there)
      if (.not. is_there) return
      call march(from, settled, marched, found)
      result%work = result%work + settled%work
      if (verdict_on_work() == verdict%interrupted) result%status = outcome%interrupted
      if (work_is_over()) return                      ! there is a motion, however late it is
      if (settled%status /= outcome%marched .and. settled%status /= outcome%several) then
         if (allocated(settled%message)) result%message = settled%message
         return
      end if
      estimate = estimate_of(marched)
      estimate_before = estimate_of(result)
      apart = distance(top, found, .false.)
      if (estimate_before < reliable .and. apart > safety*(estimate + estimate_before)) then
         result%message = "marching from it leads to another motion, "//rounded(apart)//" of it away"
         return
      end if
      if (estimate >= estimate_before) return
      marched%status = status_within(scene, settled, marched)
      marched%work = result%work
      marched%iterations = result%iterations
      marched%evaluations = result%evaluations
      marched%rescue = result%rescue
      marched%n_rungs = result%n_rungs
      marched%rung_difference = apart
      marched%setup_seconds = result%setup_seconds
      marched%solver_seconds = result%solver_seconds
      marched%certificate_seconds = result%certificate_seconds
      marched%certificate_cpu_seconds = result%certificate_cpu_seconds
      marched%message = marched%message//"; from a balance with an estimate of "//rounded(estimate_before)
      result = marched
   end subroutine march_from_balance

   !> Status of a motion that was marched: an answer where the estimate is within the tolerance.
   pure integer function status_within(scene, settled, result) result(status)
      type(scene_t), intent(in) :: scene
      type(settled_t), intent(in) :: settled
      type(motion_result_t), intent(in) :: result

      status = merge(settled%status, outcome%truncated, estimate_of(result) <= scene%accuracy%tolerance)
   end function status_within

   !> Whether a marched motion would be an answer.
   pure logical function can_march(scene)
      type(scene_t), intent(in) :: scene

      can_march = scene%accuracy%grows_set .and. size(scene%laws) > 0 .and. .not. any(scene%tones%is_unknown) .and. &
                  .not. scene%normal_mode%is_asked
   end function can_march

   !> Gives the scene with the motion of a rung as its start, in all degrees of freedom.
   subroutine start_on(scene, rung, from, is_there)
      type(scene_t), intent(in) :: scene
      type(rung_t), intent(in) :: rung
      type(scene_t), intent(out) :: from
      logical, intent(out) :: is_there
      type(error_t), allocatable :: error
      type(motion_result_t) :: whole
      integer :: i

      is_there = scene%structure%n_dofs <= most_dense
      if (.not. is_there) return
      from = scene
      from%may_integrate = .false.
      from%certificate%is_on = .false.
      from%stability%method = stability_method%off
      from%output%dofs = [(i, i=1, scene%structure%n_dofs)]
      call put_on_rung(from, scene, rung, error)
      if (.not. allocated(error)) call solve_motion(from, whole, error, rung%unknowns)
      is_there = .not. allocated(error) .and. whole%status == outcome%converged
      if (.not. is_there) return
      from%certificate = scene%certificate
      from%stability = scene%stability
      from%output = scene%output
      from%start = as_amplitudes(transpose(cmplx(whole%coefficients(1, :, :), -whole%coefficients(2, :, :), wp)))
   end subroutine start_on

   !> Marches with candidates in a box, then in the next one of twice the order where they leave too much, and keeps what matters of
   !> the best of them. Lines beyond a small box look as if the motion did not repeat, so a larger box has the last word. Without a
   !> motion there is only what is said of it.
   subroutine march(scene, settled, result, found)
      type(scene_t), intent(in), target :: scene
      type(settled_t), intent(out) :: settled
      type(motion_result_t), intent(inout) :: result
      type(rung_t), intent(out) :: found                              !! its set and motion
      type(refined_record_t) :: record

      record%scene => scene
      record%here = scene
      record%here%march%aim = nearly*scene%accuracy%tolerance
      record%here%march%tolerance = max(scene%march%tolerance, share_of_steps*record%here%march%aim)
      record%here%certificate%truncation = min(scene%certificate%truncation, scene%accuracy%tolerance)
      record%coordinates = coordinates_of(scene)
      record%room = share_of_marched*scene%accuracy%max_harmonics
      record%order = first_order(scene, candidates_of_kept*record%room)
      record%most_work = 2.0_wp*scene%march%work_limit - result%march_work   ! two methods may take as much
      record%most_failures = huge(1)
      record%result = result
      call new_lowest_set(record%candidates, scene%tones%n_tones, loaded_tuples(scene), record%error, record%order)
      if (.not. allocated(record%error)) call refine(record)
      settled = record%settled
      settled%work = record%work
      found = record%found
      result = record%result
      result%work = record%work
      result%march_work = record%work
      result%n_motions = settled%n_motions
      if (allocated(settled%message)) result%message = settled%message
   end subroutine march

   !> Marches with the candidates chosen last, and keeps what was found where it is the best so far.
   subroutine refined_record_solve(self, is_solved)
      class(refined_record_t), intent(inout) :: self
      logical, intent(out) :: is_solved
      type(motion_result_t) :: result
      type(rung_t) :: found
      type(settled_t) :: settled

      is_solved = .false.
      call put_on_set(self%here, self%scene, self%candidates)
      self%here%march%work_limit = 0.5_wp*max(0.0_wp, self%most_work - self%work)
      call self%scene%callbacks%time_domain_solver%settle(self%here, self%coordinates%dofs, settled, self%error)
      self%work = self%work + settled%work
      settled%work = self%work
      if (allocated(self%error)) then
         if (self%n_levels == 0) self%settled%message = "marching: "//self%error%message
         return
      end if
      if (self%n_found == 0) self%settled = settled
      is_solved = any(settled%status == [outcome%marched, outcome%several])
      self%is_ended = .not. (is_solved .or. any(settled%status == [outcome%subharmonic, outcome%broadband]))
      if (work_is_over() .or. .not. is_solved) return
      result = self%result
      call keep_lines(self%here, self%coordinates, self%room, settled, result, found)
      self%n_found = self%n_found + 1
      if (self%n_found == 1 .or. estimate_of(result) < self%estimate) then
         self%settled = settled
         self%result = result
         self%found = found
         self%estimate = estimate_of(result)
      end if
      self%result%n_rungs = self%n_found
      self%is_ended = settled%change_by_steps > self%scene%accuracy%tolerance   ! of which a larger box sees nothing
   end subroutine refined_record_solve

   !> Chooses the candidates in a box of twice the order, as far as there is room and work for them.
   subroutine refined_record_choose(self, is_there)
      class(refined_record_t), intent(inout) :: self
      logical, intent(out) :: is_there

      is_there = .false.
      self%order = 2*self%order
      call new_lowest_set(self%candidates, self%scene%tones%n_tones, loaded_tuples(self%scene), self%error, self%order)
      if (allocated(self%error)) return
      if (self%candidates%n_harmonics > candidates_of_kept*self%room) return
      is_there = self%work < self%most_work
      if (.not. is_there .and. self%n_found == 0) call leave_open(self%settled, self%here%harmonics%n_harmonics)
   end subroutine refined_record_choose

   logical function refined_record_is_accurate(self) result(is_accurate)
      class(refined_record_t), intent(inout) :: self

      is_accurate = self%estimate <= self%scene%accuracy%tolerance
   end function refined_record_is_accurate

   logical function refined_record_is_over(self) result(is_over)
      class(refined_record_t), intent(inout) :: self

      is_over = self%is_ended .or. work_is_over()
   end function refined_record_is_over

   !> What a box leaves may be lines of the next one, for which no work is left: nothing is known of the motion.
   subroutine leave_open(settled, n_candidates)
      type(settled_t), intent(inout) :: settled
      integer, intent(in) :: n_candidates

      settled%status = outcome%pending
      settled%message = "time integration over "//to_text(settled%n_periods)//" periods of the slowest tone: "// &
                        to_text(n_candidates)//" tuples leave "//rounded(settled%spread)// &
                        " of the worst quarter, and there is no work left for more; raise &solver rescue_work"
   end subroutine leave_open

   !> Order of the first box of candidates: with one tone or a coarse tolerance fewer than there is room for.
   pure integer function first_order(scene, most)
      type(scene_t), intent(in) :: scene
      integer, intent(in) :: most                                     !! candidates

      associate (n_tones => scene%tones%n_tones, tolerance => scene%accuracy%tolerance)
         first_order = min(ceiling(min(1.0e6_wp, tolerance**(-merge(fall_of_one_tone, fall, n_tones == 1)))), &
                           int(0.5_wp*((2.0_wp*most)**(1.0_wp/n_tones) - 1.0_wp)))
         first_order = max(first_order, lowest_order(n_tones))
      end associate
   end function first_order

   !> Keeps the candidates that matter, and the motion in them. The estimate counts what the others carry.
   subroutine keep_lines(scene, coordinates, room, settled, result, found)
      type(scene_t), intent(in) :: scene                              !! on all candidates
      type(coordinates_t), intent(in) :: coordinates
      integer, intent(in) :: room                                     !! tuples
      type(settled_t), intent(in) :: settled
      type(motion_result_t), intent(inout) :: result
      type(rung_t), intent(out) :: found
      type(error_t), allocatable :: error
      type(scene_t) :: here
      type(settled_t) :: kept
      real(wp) :: carried(scene%harmonics%n_harmonics), tail
      logical :: is_kept(scene%harmonics%n_harmonics), is_needed(scene%harmonics%n_harmonics)
      integer, allocatable :: places(:)
      integer :: h, k

      carried = 0.0_wp
      do k = 1, size(settled%averages, 2)
         carried = max(carried, abs(settled%averages(:, k))/max(norm2(abs(settled%averages(:, k))), tiny(1.0_wp)))
      end do
      is_needed = [(sum(abs(scene%harmonics%tuples(:, h))) <= 1 .or. .not. scene%loads%is_zero_at(h), h=1, size(carried))]
      tail = share_of_tail*scene%march%aim
      places = largest_places(merge(huge(1.0_wp), carried, is_needed), tail, room)
      is_kept = .false.
      is_kept(places) = .true.
      tail = norm2(pack(carried, .not. is_kept))
      call new_harmonics(found%set, scene%harmonics%tuples(:, places), error)
      if (allocated(error)) return                                    ! cannot be: they are tuples of a set
      here = scene
      call put_on_set(here, scene, found%set)
      kept = settled
      kept%amplitudes = settled%amplitudes(:, places)
      kept%averages = settled%averages(places, :)
      call keep_marched(here, coordinates, kept, result)
      result%certificate%truncation = hypot(settled%spread, tail)
      found%n_samples = samples_for(found%set%highest, degree_of(scene))
      found%unknowns = guess_from(here, coordinates, kept)
      result%harmonics = found%set
      result%n_samples = found%n_samples
   end subroutine keep_lines

   !> Tuples of the scene that have a load or a first guess.
   pure function loaded_tuples(scene) result(tuples)
      type(scene_t), intent(in) :: scene
      integer, allocatable :: tuples(:, :)
      integer :: h

      tuples = scene%harmonics%tuples(:, pack([(h, h=1, scene%harmonics%n_harmonics)], &
         [(.not. (scene%loads%is_zero_at(h) .and. scene%start%is_zero_at(h)), h=1, scene%harmonics%n_harmonics)]))
   end function loaded_tuples
end module hb_march_to_tolerance
