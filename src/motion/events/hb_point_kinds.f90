!> The kinds of points of a curve: one table, with all that curves, inputs, result files and pictures need of a kind.
module hb_point_kinds
   use hb_bifurcation, only: bifurcation
   implicit none
   private
   public :: beginning, curve_kind, curve_kind_names, curve_kinds, kind_attribute_t, kind_attributes, located_by
   public :: kind_of_bifurcation, point_kind_t, response_keys, response_kinds, target_keys

   !> Kinds of points of a curve; numbers as in the result file.
   type :: curve_kind_t
      integer :: none = 0
      integer :: regular = 1                                          !! a step of the curve
      integer :: start = 2                                            !! the point from which it is followed
      integer :: fold = 3                                             !! the value reverses
      integer :: peak = 4                                             !! maximum of a response
      integer :: value = 5                                            !! a value that was requested
      integer :: end = 6                                              !! an end of the range, or the point at which the curve closes
      integer :: branch = 7 !! intersection with another curve: the determinant changes sign
      integer :: period_doubling = 8    !! a multiplier passes -1: motions of twice the period
      integer :: neimark_sacker = 9    !! a pair of them crosses the unit circle: an additional tone
      integer :: symmetry_breaking = 10    !! a multiplier passes 1 without any of the other events
      integer :: grazing = 11                                           !! a contact begins or becomes permanent
      integer :: minimum = 12                                         !! of a response
      integer :: amplitude = 13                                       !! a response has a requested amplitude
      integer :: resonance = 14                                       !! a harmonic is in quadrature with its load
      integer :: phase = 15                                           !! a harmonic lags its load by a requested angle
   end type curve_kind_t
   type(curve_kind_t), parameter :: curve_kind = curve_kind_t()

   !> What changes its sign at a located point.
   type :: located_by_t
      integer :: nothing = 0                                          !! of these: steps, requested values, ends
      integer :: value = 1                                            !! the component of the tangent along the moving value
      integer :: determinant = 2                                      !! that of the tangent
      integer :: multipliers = 3                                      !! a function of the multipliers
      integer :: contact = 4                                          !! an extreme of a switching function of a law
      integer :: response = 5                                         !! the function of a response of the request
   end type located_by_t
   type(located_by_t), parameter :: located_by = located_by_t()

   !> Other motions that begin at a point, besides those of a branch point.
   type :: beginning_t
      integer :: nothing = 0
      integer :: doubled_period = 1                                   !! of twice the period
      integer :: torus = 2                                            !! with an additional tone
   end type beginning_t
   type(beginning_t), parameter :: beginning = beginning_t()

   type :: point_kind_t
      character(17) :: name = ""                                      !! in inputs and result files
      integer :: by = located_by%nothing                              !! what changes its sign there
      character(21) :: label = "", plural = ""                        !! in pictures; empty: not marked
      character(8) :: mark = ""                                       !! shape in pictures
      character(12) :: key = ""                                       !! of a curve, which names responses; empty: none
      character(12) :: targets = ""                                   !! key of the values at which these are located; empty: none
      logical :: needs_load = .false.                                 !! it compares a harmonic with its load
      logical :: has_slope = .false.                                  !! the slope of the square is, or is that of, its function
      logical :: is_extreme = .false.                                 !! of the moving value or a response
      integer :: sense = 0                                            !! of an extreme of a response: 1 maximum, -1 minimum
      logical :: is_bifurcation = .false.                             !! the stability may change there
      integer :: bifurcation = 0                                      !! one of hb_bifurcation, if multipliers pass the unit circle
      logical :: multipliers_jump = .false.                           !! stability may change there without a bifurcation
      integer :: begins = beginning%nothing                           !! if multipliers jump, only where stability is lost
      logical :: has_derivatives = .false.                            !! its position has derivatives by numbers of the model
      logical :: has_direction = .true.                               !! the direction of the curve is stored
   end type point_kind_t

   type(point_kind_t), parameter :: curve_kinds(0:*) = [ &
      point_kind_t("none"), &
      point_kind_t("regular"), &
      point_kind_t("start"), &
      point_kind_t("fold", located_by%value, "fold", "folds", "circle", &
                   is_extreme=.true., is_bifurcation=.true., bifurcation=bifurcation%branch, has_derivatives=.true.), &
      point_kind_t("peak", located_by%response, "peak", "peaks", "up", "peak_of", &
                   has_slope=.true., is_extreme=.true., sense=1, has_derivatives=.true.), &
      point_kind_t("value", has_direction=.false.), &
      point_kind_t("end", has_direction=.false.), &
      point_kind_t("branch", located_by%determinant, "branch point", "branch points", "diamond", is_bifurcation=.true., &
                   bifurcation=bifurcation%branch), &
      point_kind_t("period_doubling", located_by%multipliers, "period doubling", "period doublings", "square", &
                   is_bifurcation=.true., bifurcation=bifurcation%doubling, &
                   begins=beginning%doubled_period, has_derivatives=.true.), &
      point_kind_t("neimark_sacker", located_by%multipliers, "Neimark-Sacker point", "Neimark-Sacker points", "hexagon", &
                   is_bifurcation=.true., bifurcation=bifurcation%torus, begins=beginning%torus, has_derivatives=.true.), &
      point_kind_t("symmetry_breaking", located_by%multipliers, "change of stability", "changes of stability", "pentagon", &
                   is_bifurcation=.true., bifurcation=bifurcation%branch, has_direction=.false.), &
      point_kind_t("grazing", located_by%contact, "grazing point", "grazing points", "down", multipliers_jump=.true., &
                   begins=beginning%torus, has_direction=.false.), &
      point_kind_t("minimum", located_by%response, "minimum", "minima", "left", "minimum_of", &
                   has_slope=.true., is_extreme=.true., sense=-1, has_derivatives=.true.), &
      point_kind_t("amplitude", located_by%response, "given amplitude", "given amplitudes", "right", "amplitude_of", &
                   "amplitudes", has_slope=.true., has_derivatives=.true.), &
      point_kind_t("resonance", located_by%response, "phase resonance", "phase resonances", "octagon", "resonance_of", &
                   needs_load=.true., has_derivatives=.true.), &
      point_kind_t("phase", located_by%response, "given phase", "given phases", "octagon", "phase_of", "phases", &
                   needs_load=.true., has_derivatives=.true.)]

   character(*), parameter :: curve_kind_names(0:*) = curve_kinds%name

   integer :: i_kind                                                  ! of implied loops

   !> Keys of a curve that name responses, those of the values at which these are located (blank: none), and the kind of point.
   character(*), parameter :: response_keys(*) = pack(curve_kinds%key, curve_kinds%key /= "")
   character(*), parameter :: target_keys(*) = pack(curve_kinds%targets, curve_kinds%key /= "")
   integer, parameter :: response_kinds(*) = pack([(i_kind, i_kind=0, ubound(curve_kinds, 1))], curve_kinds%key /= "")

   type :: kind_attribute_t
      character(13) :: name
      character(400) :: text = ""
   end type kind_attribute_t

contains

   !> The kind of the points at which a bifurcation of hb_bifurcation is located from multipliers.
   pure integer function kind_of_bifurcation(number) result(kind)
      integer, intent(in) :: number

      kind = findloc(curve_kinds%by == located_by%multipliers .and. curve_kinds%bifurcation == number, .true., dim=1) - 1
   end function kind_of_bifurcation

   !> Attributes of the column of kinds in files: what post-processing needs to name and draw the points, the keys that name
   !> responses, each with a colon and the key of its values if it has any, in the order in which responses are numbered, and the
   !> kinds of points that `origin` of a curve accepts.
   pure function kind_attributes() result(attributes)
      type(kind_attribute_t) :: attributes(6)
      type(point_kind_t) :: row
      integer :: k

      attributes%name = [character(13) :: "flag_labels", "flag_plurals", "flag_marks", "bifurcations", "response_keys", &
                         "origins"]
      do k = 0, ubound(curve_kinds, 1)
         row = curve_kinds(k)
         if (row%mark == "") then
            row%label = row%name
            row%plural = row%name
            row%mark = "none"
         end if
         call add(attributes(1)%text, ", ", row%label)
         call add(attributes(2)%text, ", ", row%plural)
         call add(attributes(3)%text, " ", row%mark)
         if (row%is_bifurcation) call add(attributes(4)%text, " ", row%name)
         if (row%begins /= beginning%nothing .and. .not. row%multipliers_jump) call add(attributes(6)%text, " ", row%name)
      end do
      do k = 1, size(response_keys)
         call add(attributes(5)%text, " ", response_keys(k))
         if (target_keys(k) /= "") call add(attributes(5)%text, ":", target_keys(k))
      end do

   contains

      pure subroutine add(text, separator, word)
         character(*), intent(inout) :: text
         character(*), intent(in) :: separator, word

         if (len_trim(text) == 0) then
            text = word
         else
            text = trim(text)//separator//trim(word)
         end if
      end subroutine add
   end function kind_attributes
end module hb_point_kinds
